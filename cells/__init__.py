"""Simulation of HEX-o-SKIN cells, their patches and tactile sheets, and the process that runs them."""
