"""What was found, in words: keyed blocks of sentences, set in 78 columns for a shell, a screen or a page."""
