"""Children do not outlive their launcher, however it ends."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

from agents.process.lifeline import VARIABLE, Lifeline, start

PATIENCE_S = 20.0


def running(process: psutil.Process) -> bool:
    """Not ended; an orphan that has, may wait for the system's init to take notice."""
    try:
        return process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


@pytest.mark.processes
def test_no_child_survives_the_sigkill_of_its_launcher(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "tests.agents.supervised_child", "launch", str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as launcher:
        try:
            assert launcher.stdout is not None
            line = launcher.stdout.readline().split()
            children = [psutil.Process(int(pid)) for pid in line]
            grandchildren = [descendant for child in children for descendant in child.children()]
            assert len(children) == 3
            assert len(grandchildren) == 1  # holds all it could inherit, and must not keep the others alive
            began = time.monotonic()
        finally:
            launcher.kill()
    while any(running(child) for child in children) and time.monotonic() < began + PATIENCE_S:
        time.sleep(0.01)
    still = [child for child in children if running(child)]
    print(f"all gone after {time.monotonic() - began:.3f} s")
    for process in grandchildren:
        process.kill()
    assert not still


def test_a_process_that_nobody_supervises_has_no_lifeline() -> None:
    assert VARIABLE not in os.environ
    assert start() is False


def test_neither_end_is_inherited_by_accident() -> None:
    with Lifeline() as lifeline:
        assert not os.get_inheritable(lifeline.read_end)
        assert not os.get_inheritable(lifeline._write_end)
        lifeline.close()


@pytest.mark.processes
def test_the_end_of_the_lifeline_is_a_sigterm_to_the_child() -> None:
    code = (
        "import time; from agents.process.lifeline import start; start()\n"
        "print('ready', flush=True); time.sleep(60)"
    )
    with Lifeline() as lifeline:
        child = subprocess.Popen(
            [sys.executable, "-c", code],
            stdout=subprocess.PIPE,
            pass_fds=(lifeline.read_end,),
            env={**os.environ, **lifeline.environment},
        )
        assert child.stdout is not None
        assert child.stdout.readline() == b"ready\n"
    assert child.wait(timeout=PATIENCE_S) == -signal.SIGTERM
    child.stdout.close()
