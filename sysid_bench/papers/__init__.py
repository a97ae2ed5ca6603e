"""What the two papers claim, judged on this suite's own results: claims, misprints and the page that shows them."""
