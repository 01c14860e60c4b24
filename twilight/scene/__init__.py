"""From a validated configuration to what a solver takes: medium, suns, plan, and the record of what was asked."""
