"""The likelihood of a campaign: correlated noise, and deviations of the bench with priors that are marginalised."""
