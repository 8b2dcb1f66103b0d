"""Learning what evidence means: weights from sensory features to channels, from reward alone."""
