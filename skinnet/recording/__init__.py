"""Recordings of runs as MCAP files: recorder process, reader, playback and replay."""
