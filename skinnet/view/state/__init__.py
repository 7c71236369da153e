"""State of a run as its messages tell it, without I/O."""
