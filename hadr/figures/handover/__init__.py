"""Pictures and films of the handover."""
