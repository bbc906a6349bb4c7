"""Causes whose values differ between recordings: what each recording says alone, and the search with such values."""
