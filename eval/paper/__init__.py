"""The paper's claims and figures, computed anew, and what lies beyond them."""
