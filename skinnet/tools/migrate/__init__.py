"""Rewriting of files of earlier formats: deployments with their comments, memories, recordings, summaries."""
