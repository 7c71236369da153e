"""Cell-to-cell packet network: topology, routes, faults, power and the compiled packet kernel."""
