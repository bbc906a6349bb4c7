"""The bytes of an MCAP file: its records written, walked through, and held against their checksums."""
