"""Who may open the page, and what comes from browsers."""
