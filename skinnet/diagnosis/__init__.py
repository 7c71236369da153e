"""Diagnosis of a deployment: findings on model, skin, servos and what happens at home."""
