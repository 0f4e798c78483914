"""From recordings of a real sensor to the parameters of its laws, and how well those predict. Needs scipy."""
