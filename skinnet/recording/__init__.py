"""Recordings: what a run said, as one MCAP file, and what one can do with it afterwards."""
