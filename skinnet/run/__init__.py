"""Run management: launching and supervision of processes, observer endpoint, summary."""
