"""How far an answer is from the truth: measures, advice on the step, audits, the measured trade, the extremes."""
