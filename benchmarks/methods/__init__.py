"""Models and fits used only for comparison in scores; the package does not need them."""
