"""The terminal app."""

import os

# An answer to a key waits for Textual's next moment to draw: at its usual 60 a second half of what it takes in all.
# Textual reads it when it is imported; what there is to draw, and so the work, stays the same.
os.environ.setdefault("TEXTUAL_FPS", "120")
