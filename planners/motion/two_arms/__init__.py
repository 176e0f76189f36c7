"""Two arms over one tray."""
