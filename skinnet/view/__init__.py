"""The live page: what a run, or the recording of one, looks like in a browser."""
