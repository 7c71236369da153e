"""Packet networks in CSV files: tables, topologies, simulations."""
