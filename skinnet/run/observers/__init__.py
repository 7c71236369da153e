"""Access for external clients: observer endpoint, requests, live page, process load."""
