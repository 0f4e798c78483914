"""Level 4: ElasticLayerTaxel, a bonded elastic layer, solved."""
