"""Tables of trials and of evidence: of people, animals and models; one set of guards."""
