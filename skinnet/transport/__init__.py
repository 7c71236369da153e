"""How messages get from process to process: Zenoh, or memory in one process."""
