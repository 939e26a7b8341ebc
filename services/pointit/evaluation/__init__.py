"""What PointIt's estimates are worth, measured on recordings of people: our cores beside named baselines."""
