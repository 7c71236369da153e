"""Formats of earlier versions: vocabularies by which old files are read as new ones."""
