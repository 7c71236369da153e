"""Long-term memory of a robot: its learnt structure and taught skills, in one SQLite file."""
