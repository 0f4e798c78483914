"""The model of level 3: ElastomerTaxel, a soft skin whose markers move."""
