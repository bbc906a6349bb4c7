"""Rig -> clock -> sampler -> ledger -> recorder and publisher; the daemon; recordings read back."""
