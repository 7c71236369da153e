"""What the robot finds out about itself: structure and sensory-motor map."""
