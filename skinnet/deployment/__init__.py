"""Deployment files: schema, loading, and checks across keys."""

from skinnet.deployment.load import load, resolved_json
from skinnet.deployment.schema import Deployment

__all__ = ["Deployment", "load", "resolved_json"]
