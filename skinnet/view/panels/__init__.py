"""The panels beside the body: what they show as HTML, made from the scene without I/O.

What hardly changes is drawn once; what changes comes as a style sheet for it, which is short and leaves the
elements in place, so that the one under the pointer stays there.
"""
