"""What all tests share."""

import os


def pytest_xdist_auto_num_workers() -> int:
    """One worker more than cores: many tests wait for processes and vehicles that run in real time."""
    return (os.cpu_count() or 1) + 1
