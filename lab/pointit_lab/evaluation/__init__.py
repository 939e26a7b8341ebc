"""Accuracy of PointIt's estimates on recordings of people: our cores compared with named baselines."""
