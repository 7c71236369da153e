"""Deployment files: schema, loading, and checks across keys."""

from skinnet.deployment.deployment import Deployment
from skinnet.deployment.load import load, resolved_json

__all__ = ["Deployment", "load", "resolved_json"]
