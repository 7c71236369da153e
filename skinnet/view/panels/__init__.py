"""HTML panels beside the body view, rendered from the scene without I/O.

Static elements are rendered once (`render`); changes are sent as a short style sheet (`render_style`,
`render_tooltips`), which keeps the elements and thus the hover state.
"""
