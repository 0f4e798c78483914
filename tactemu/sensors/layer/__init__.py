"""The model of level 4: ElasticLayerTaxel, a bonded elastic layer whose contact is solved."""
