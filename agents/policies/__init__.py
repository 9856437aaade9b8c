"""What chooses an action for an observation: rules, networks and memories."""
