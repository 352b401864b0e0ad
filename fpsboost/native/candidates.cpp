// Candidate motions of the nodes: the motion of points is projected to time t and votes at the nodes where it lands.
#include "candidates.h"
#include "rounding.h"
#include "scratch.h"

namespace {

// Sums over the votes for a candidate.
struct VoteSums {
  float dx, dy;
  float sure, acceleration_x, acceleration_y, squared_acceleration;  // of votes whose acceleration is known
  float dx_along_x, dy_along_x, dx_along_y, dy_along_y;
};

static_assert(sizeof(VoteSums) == SUMS_PER_CANDIDATE * sizeof(float));

// What is listed of a node so far, and the sums of all nodes in the order in which they were found.
struct NodeVotes {
  int32_t *listed;
  float *votes;
  int32_t *places;
  VoteSums *sums;

  NodeVotes(const CollectedVotes &all, Int row, Int column) : sums(as<VoteSums *>(all.sums.data)) {
    const Int node = row * all.listed.shape[1] + column, capacity = all.votes.shape[2];
    listed = all.listed.data + node;
    votes = all.votes.data + node * capacity;
    places = all.places.data + node * capacity;
  }
  VoteSums &of(Int k) const { return sums[places[k]]; }
};

// Part of an axis, relative to the frame corner.
struct Span {
  float first, last;
};

// From where to where, along an axis, what moves like this is within both frames; `t` is the distance from this one.
FORCE_INLINE Span overlap_span(float motion, float t, Int size) {
  const float first = max(0.0f, max((t - 1) * motion, t * motion));
  const float last = float(size) - max(0.0f, max((1 - t) * motion, -t * motion));
  return {first, max(last, first)};
}

struct Nodes {
  Int first, last;
};

// The nodes in whose support a motion lands; beyond what both frames see, all are as the outermost.
//
// Content that enters or leaves the frame has no match; it is assumed to move as its neighbours do.
FORCE_INLINE Nodes nodes_within(float landing, float support, const Span &seen, Int spacing, Int count) {
  const float middle = 0.5f * float(spacing), per_cell = 1 / float(spacing);
  Nodes nodes{0, count - 1};
  if (landing - support > seen.first)
    nodes.first = max(truncate(__builtin_ceilf((landing - middle - support) * per_cell)), Int(0));
  if (landing + support < seen.last)
    nodes.last = min(truncate(__builtin_floorf((landing - middle + support) * per_cell)), count - 1);
  return nodes;
}

// Adds a vote to the first candidate of a node whose mean is near, or to a new one as long as there is room.
FORCE_INLINE void add_vote(const NodeVotes &node, const CollectedVotes &all, float tolerance, float vote, float sign,
                           const Motion &motion, float certainty) {
  const Int listed = *node.listed;
  Int k = 0;
  for (; k < listed; k++) {
    const float share = node.votes[k];
    const VoteSums &sums = node.of(k);
    if (max(absolute(sums.dy - motion.dy * share), absolute(sums.dx - motion.dx * share)) < tolerance * share) break;
  }
  if (k == all.votes.shape[2]) return;
  if (k == listed) {
    Int &total = *all.total.data;
    ++*node.listed;
    node.votes[k] = 0;
    node.places[k] = int32_t(total);
    node.sums[total] = {};
    ++total;
  }
  node.votes[k] += vote;
  VoteSums &sums = node.of(k);
  sums.dx += vote * motion.dx;
  sums.dy += vote * motion.dy;
  const float turned = sign * vote, sure = vote * certainty;
  sums.dx_along_x += turned * motion.dx_along_x;
  sums.dy_along_x += turned * motion.dy_along_x;
  sums.dx_along_y += turned * motion.dx_along_y;
  sums.dy_along_y += turned * motion.dy_along_y;
  sums.sure += sure;
  sums.acceleration_x += sure * motion.acceleration_x;
  sums.acceleration_y += sure * motion.acceleration_y;
  sums.squared_acceleration +=
      sure * (motion.acceleration_x * motion.acceleration_x + motion.acceleration_y * motion.acceleration_y);
}

// Writes the `most` candidates with the most votes in decreasing order, those with as many as they were found.
FORCE_INLINE void order_by_votes(const float *votes, Int count, Int most, int32_t *order) {
  for (Int k = 0; k < count; k++) {
    Int place = min(k, most);
    if (place == most && (most == 0 || !(votes[order[--place]] < votes[k]))) continue;
    for (; place > 0 && votes[order[place - 1]] < votes[k]; place--) order[place] = order[place - 1];
    order[place] = int32_t(k);
  }
}

// The mean acceleration of a candidate, as far as its votes agree on it.
FORCE_INLINE void set_acceleration(const VoteSums &sums, float vote, float tolerance, Motion &motion) {
  motion.acceleration_x = motion.acceleration_y = 0;
  if (!(sums.sure > 0)) return;
  const float sure = sums.sure, ax = sums.acceleration_x / sure, ay = sums.acceleration_y / sure;
  const float variance = max(0.0f, sums.squared_acceleration / sure - ax * ax - ay * ay);
  const float squared = tolerance * tolerance;
  float belief = sure / (sure + UNKNOWN * vote) * tolerance * tolerance / (squared + variance);
  // zero motion has no acceleration: a frozen frame stays unchanged
  belief *= min(1.0f, 4 * (absolute(motion.dx) + absolute(motion.dy)));
  motion.acceleration_x = belief * ax;
  motion.acceleration_y = belief * ay;
}

}  // namespace

KERNEL(void, collect_candidates, const CollectCandidates &args) {
  const View<const float, 3> vectors(args.points.vectors), accelerations(args.points.accelerations);
  const View<const float, 4> gradients(args.points.gradients);
  const View<const float, 2> trust(args.points.trust);
  const CollectedVotes &all = args.collected;
  const Int rows = all.listed.shape[0], columns = all.listed.shape[1], spacing = all.spacing, step = args.step;
  const float sign = args.sign, t = args.t, support = args.support, tolerance = args.tolerance;
  const float middle = 0.5f * float(spacing), curve = t * (1 - t) * 0.5f;
  for (Int i = 0; i < vectors.shape[0]; i++) {
    const float y = float(min(i * step + step / 2, args.height - 1)) + 0.5f;  // relative to the frame corner
    for (Int j = 0; j < vectors.shape[1]; j++) {
      const float x = float(min(j * step + step / 2, args.width - 1)) + 0.5f;
      const float *vector = vectors.ptr(i, j), *change = accelerations.ptr(i, j), *gradient = gradients.ptr(i, j);
      Motion motion{0, 0, change[1], change[2], gradient[0], gradient[1], gradient[2], gradient[3]};
      const float landing_x = x + t * vector[0] - curve * motion.acceleration_x,
                  landing_y = y + t * vector[1] - curve * motion.acceleration_y;
      const Span down_seen = overlap_span(vector[1], t, args.height),
                 across_seen = overlap_span(vector[0], t, args.width);
      const Nodes down_nodes = nodes_within(landing_y, support, down_seen, spacing, rows);
      const Nodes across_nodes = nodes_within(landing_x, support, across_seen, spacing, columns);
      for (Int row = down_nodes.first; row <= down_nodes.last; row++) {
        const float node_y = middle + float(row * spacing);
        const float down = 1 - absolute(landing_y - min(down_seen.last, max(down_seen.first, node_y))) / support;
        for (Int column = across_nodes.first; column <= across_nodes.last; column++) {
          const float node_x = middle + float(column * spacing);
          const float nearest_x = min(across_seen.last, max(across_seen.first, node_x));
          const float across = 1 - absolute(landing_x - nearest_x) / support;
          const float vote = trust(i, j) * down * across;
          if (vote <= 0) continue;
          // extrapolate zoom and rotation to the node
          const float offset_x = node_x - landing_x, offset_y = node_y - landing_y;
          motion.dx = sign * (vector[0] + offset_x * gradient[0] + offset_y * gradient[2]);
          motion.dy = sign * (vector[1] + offset_x * gradient[1] + offset_y * gradient[3]);
          add_vote(NodeVotes(all, row, column), all, tolerance, vote, sign, motion, change[0]);
        }
      }
    }
  }
}

KERNEL(Int, list_candidates, const ListCandidates &args) {
  const View<int32_t, 2> listed_of(args.listed);
  const View<float, 4> motions_of(args.motions);
  const View<float, 3> weights_of(args.weights);
  const Int rows = listed_of.shape[0], columns = listed_of.shape[1], room = weights_of.shape[2];
  const float prior = args.zero_motion_prior, tolerance = args.acceleration_tolerance;
  const float min_share = args.min_share, min_weight = args.min_weight;
  Workspace workspace(args.scratch);
  int32_t *order = workspace.take<int32_t>(room);
  if (workspace.is_counting()) return workspace.size();
  for (Int row = 0; row < rows; row++)
    for (Int column = 0; column < columns; column++) {
      const NodeVotes node(args.collected, row, column);
      Motion *motions = as<Motion *>(motions_of.ptr(row, column));
      float *weights = weights_of.ptr(row, column), all_votes = 0;
      const Int count = *node.listed, listed = min(count, room - 1);
      for (Int k = 0; k < count; k++) all_votes += node.votes[k];
      all_votes += prior;
      for (Int place = 0; place < room; place++) weights[place] = 0;
      order_by_votes(node.votes, count, listed, order);
      for (Int place = 0; place < listed; place++) {
        const Int k = order[place];
        const VoteSums &sums = node.of(k);
        const float vote = node.votes[k];
        Motion &motion = motions[place];
        motion.dx = sums.dx / vote;
        motion.dy = sums.dy / vote;
        motion.dx_along_x = sums.dx_along_x / vote;
        motion.dy_along_x = sums.dy_along_x / vote;
        motion.dx_along_y = sums.dx_along_y / vote;
        motion.dy_along_y = sums.dy_along_y / vote;
        set_acceleration(sums, vote, tolerance, motion);
        weights[place] = vote / all_votes + min_share;
      }
      motions[listed] = {};
      weights[listed] = prior / all_votes + min_share;
      listed_of(row, column) = int32_t(listed + 1);
      float best = 0, total = 0;
      for (Int place = 0; place <= listed; place++) best = max(weights[place], best);
      for (Int place = 0; place <= listed; place++) {
        weights[place] = max(0.0f, weights[place] - min_weight * best);
        total += weights[place];
      }
      for (Int place = 0; place <= listed; place++) weights[place] /= total;
    }
  return 0;
}
