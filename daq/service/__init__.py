"""The daemon and its clients: commands, runs, publishing and replaying over Zenoh, live view."""
