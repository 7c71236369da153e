"""Command-line interface: one module per command group, all registered in `skinnet.cli.main`."""
