"""Contacts of the nursing program: frames, tracking, tactile feedback."""
