"""Teacher's finger: touches, lessons and strokes on the skin."""
