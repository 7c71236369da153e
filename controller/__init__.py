"""The brain: self-organisation, touch reactions and their safety, without ground truth."""
