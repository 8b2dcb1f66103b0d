"""Reward moves a threshold: REINFORCE, its policies, and the worlds it learns in."""
