"""HTML panels beside the body view, rendered from the scene without I/O.

Static elements are rendered once (`draw`); changes are sent as a short style sheet (`paint`, `tell`), which
keeps the elements and thus the hover state.
"""
