"""The environments of Gymnasium, single and vector, over one scene or many."""
