"""Transports of messages between processes: Zenoh, or in memory within one process."""
