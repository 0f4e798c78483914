"""The model of level 2 on point clouds: ProximityTaxel."""
