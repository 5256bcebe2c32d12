"""What covers surfaces: painted by rule, or a user's photographs."""
