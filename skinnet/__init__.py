"""skinnet simulates whole-body robot skin with the network in between."""

__version__ = "0.1.0"
__all__ = ["__version__"]
