"""Message sources of the live page: a run, or its recording."""
