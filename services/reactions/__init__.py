"""Programs and webhooks that act when people point at things."""
