// What was told of the last step is of now only while steps are made: a robot that stands is told of none, and what
// is round it, or the body itself, may have moved since.
let lasts_ns = 1e9;

// Of a recording of which not everything is shown: longer.
export function lastsFor(seconds) { lasts_ns = seconds * 1e9; }

// null: it is not of now. now_ns: of the newest status.
export const ofNow = (risk, now_ns) => (risk && !(now_ns - risk.t_ns > lasts_ns) ? risk : null);
