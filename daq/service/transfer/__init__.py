"""Recordings on their way from a daemon's folder to another machine."""
