"""The link budget of a deployment, before it runs."""
