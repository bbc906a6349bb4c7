"""Recordings without devices behind them: tables as CSV, in and out."""
