"""Network formation: cell and gateway agents, link layer, routing forest."""
