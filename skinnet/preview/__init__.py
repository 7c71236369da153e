"""Preview of a deployment's skin: pictures and a page, before any run."""
