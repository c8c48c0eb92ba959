"""What attaches to a ground station: it gets the views and the messages, and may give orders."""
