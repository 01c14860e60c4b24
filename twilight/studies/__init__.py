"""Short callers of the engine that do not know each other."""
