"""Deployments: schema, loading with clear errors, and the checks that no schema can express."""

from skinnet.deployment.load import load, resolved_json
from skinnet.deployment.schema import Deployment

__all__ = ["Deployment", "load", "resolved_json"]
