"""Learning the values of actions from reward: bandits, learners, a circuit, and people."""
