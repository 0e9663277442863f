"""What samples of the pairs' videos say of how good the pairs are."""
