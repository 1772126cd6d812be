% Writes the golden .mat files of this folder: octave-cli make_mat.m   (GNU Octave 7.3.0 made those committed)
% Sample t of axis c of recording i, all counted from 1, is 1000*i + t + c/8 newton: exact in single and double.
% In int16 files it is 1000*i + 10*t + c.
1;
function w = push(i, n_samples)
  [t, c] = ndgrid(1:n_samples, 1:6);
  w = 1000*i + t + c/8;
end

T = 24; rate_hz = 500; names = {'rice'; 'peas'; 'oat flakes'};

X = zeros(5, T, 6);
for i = 1:5, X(i, :, :) = push(i, T); end
y = names([1 2 3 1 2]); session = {'mon'; 'mon'; 'mon'; 'tue'; 'tue'};
save('-v7', 'x_y_v7.mat', 'X', 'y', 'session', 'rate_hz');
save('-v6', 'x_y_v6.mat', 'X', 'y', 'session', 'rate_hz');

turned = single(permute(X, [2 3 1]));      % (T, 6, n), labels as rows of characters
labels = char(y); fs = 500;
force = turned; save('-v7', 'single_t6n_v7.mat', 'force', 'labels', 'fs');

for i = 1:4
  data(i).wrench = push(i, T + i);         % ragged
  data(i).label = names{mod(i - 1, 3) + 1};
  data(i).session = sprintf('day%d', i);
  data(i).rate_hz = 500;
end
save('-v7', 'struct_array_v7.mat', 'data');

data = {X(1:2, :, :), X(3, :, :), X(4:5, :, :)};
materials = names;
save('-v7', 'cell_per_material_v7.mat', 'data', 'materials', 'rate_hz');

clear data
data.rice = X(1:2, :, :); data.peas = X(3:5, :, :);
save('-v7', 'struct_of_materials_v7.mat', 'data', 'rate_hz');

pushes = cell(3, 1);
for i = 1:3, pushes{i} = push(i, T + i); end
label = names;
save('-v7', 'ragged_cell_v7.mat', 'pushes', 'label', 'rate_hz');

X = zeros(5, T, 6, 'int16');
for i = 1:5, [t, c] = ndgrid(1:T, 1:6); X(i, :, :) = 1000*i + 10*t + c; end
y = [1; 2; 3; 1; 2]; materials = names;
save('-v6', 'int16_v6.mat', 'X', 'y', 'materials', 'rate_hz');

wrench = push(1, T);
save('-v4', 'one_v4.mat', 'wrench', 'rate_hz');
sparse_part = sparse([1 0; 0 2]); complex_part = 1 + 2i; empty = []; on = true; note = "gr\303\274n";
nested = {1, {2, struct('a', {{}})}};
save('-v7', 'odd_v7.mat', 'wrench', 'rate_hz', 'sparse_part', 'complex_part', 'empty', 'on', 'note', 'nested');

% what cannot be read, and must say so
save('-text', 'octave_text.mat', 'rate_hz');
