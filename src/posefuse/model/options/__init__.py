"""Options that a user can request: one frozen record per stage, combined in ``options.Options``."""
