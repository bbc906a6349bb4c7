"""Friction where joints turn or creep, judged passage by passage."""
