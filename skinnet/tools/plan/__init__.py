"""Link budget of a deployment, computed without running it."""
