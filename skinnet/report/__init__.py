"""One HTML file that tells a run: what it gave, what it looked like, and what the paper has beside it."""
