"""Simulator of whole-body robot skin: contact, cell-to-cell network, middleware, controller, MuJoCo body."""

__version__ = "0.1.0"
__all__ = ["__version__"]
