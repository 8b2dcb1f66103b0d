"""One folder per question, a room: scripts that measure and draw, their tables, and the page."""
