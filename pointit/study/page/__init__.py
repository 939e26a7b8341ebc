"""Pages of a study: the participant's and the experimenter's, in browsers."""
