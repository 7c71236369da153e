"""Contact between skin and geoms: elastic foundation, surfaces, ray casting."""
