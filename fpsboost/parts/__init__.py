"""Parts of a conversion that are made apart, on one machine or many, and joined into what one run makes."""
