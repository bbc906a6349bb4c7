"""From device blocks to joined, accounted rows: readers, trigger index, join, clocks, ledger."""
