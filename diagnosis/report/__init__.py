"""Results of a diagnosis as files, words, tables and pages."""
