"""Long-term memory: what a robot has learnt about itself and was taught, in one SQLite file."""
