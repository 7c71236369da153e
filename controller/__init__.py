"""Robot controller: self-organisation, tactile reactions and safety clamp, without ground truth."""
