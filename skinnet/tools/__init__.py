"""Tools beside single runs: link budget, stress sweeps, benchmarks."""
