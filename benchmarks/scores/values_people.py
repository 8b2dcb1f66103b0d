"""People who learn values: models of their choices and times, compared on left-out trials.

The 28 people of the probabilistic selection set learn three pairs of items, AB, CD and EF, from
rewards. The following was written down before the data were looked at; known beforehand were the
accuracy and median times of each pair, and the sums of BIC of fits without left-out trials.

Expected, with the size that would count:

1. Q with two rates predicts left-out trials better than with one: by 4 to 12 nats per person. The
   known BIC differ by 290 nats in all, for one rate without stickiness.
2. Stickiness is towards the last choice: mean start between 0.02 and 0.15 of the bound.
3. The baseline model without learning predicts left-out trials worse than Q with two rates, by 2
   to 10 nats per person, because curves rise within the session.
4. From the first 10 to the last 10 trials of a pair the share of the better item rises by 0.10 to
   0.30 in AB, and by 0 to 0.10 in EF.
5. Median times fall with the fitted difference of values: the fourth of trials with the largest
   difference is 30 to 200 ms faster than that with the smallest.
6. Errors take longer than correct responses of the same pair, by 0 to 100 ms in the median; a
   diffusion whose drift rises with learning gives a small difference of the same sign.
7. In Q with two rates gains are learned faster than losses in most people: the median of the
   log-ratio is positive. This is no claim about dopamine: see below.
8. The confidence rule with two rates predicts left-out trials as well as Q with two rates, to
   within 2 nats per person.

Asymmetry of rates and stickiness are confounded: who repeats choices whatever follows learns, in
effect, more from gains than from losses. Expected in simulated people with one rate and a start of
0.1 of the bound towards the last choice: fitted without stickiness, the mean log-ratio of the rates
is above zero; fitted with it, its interval contains zero.
"""
