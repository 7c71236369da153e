"""The cell-to-cell network: topology, routes and the compiled packet kernel."""
