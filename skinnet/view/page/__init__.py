"""Live page: server, body, charts and controls."""
