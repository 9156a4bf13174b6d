"""The app in a browser: one app process, whose screen all viewers see, and one of them types."""
