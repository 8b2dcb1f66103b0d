"""Do recorded striatal cells and choices come from one noisy sum of clicks?"""
