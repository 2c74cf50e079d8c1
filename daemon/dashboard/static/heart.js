// A worker's timer goes on where a hidden page's is slowed down: the machine and this tab are there.
setInterval(() => postMessage("beat"), 100);
