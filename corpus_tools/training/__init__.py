"""Training and scoring control models."""
