"""The set-up of a home by the page's cards: its state, its files, and the lamp whose turn it is."""
