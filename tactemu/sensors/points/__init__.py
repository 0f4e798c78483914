"""Level 2 on point clouds: ProximityTaxel."""
