"""Virtual time: the real Robot and Fusion objects of a team in one process."""
