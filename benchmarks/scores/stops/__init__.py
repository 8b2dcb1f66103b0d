"""Parts of the score of stopping."""
