"""Models and fits that only scores compare with: none of the package needs them."""
